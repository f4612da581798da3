"""An arm that moves on a page of its own: scene, motion and masses as data, drawn by three.js."""
