"""MJCF descriptions: plain form of the document, joints, geometry."""
