"""Changes within one recording: what may change, when it changes, and how much better the log then fits."""
