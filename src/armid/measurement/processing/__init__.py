"""Processing of a recording to observations: clock, delay, cleaning, derivatives, repetitions, output grid."""
