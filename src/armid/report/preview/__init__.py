"""Animated page of an arm: scene, motion and masses as data, drawn by three.js."""
