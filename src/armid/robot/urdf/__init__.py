"""URDF descriptions: tree of bodies, geometry."""
