"""Footage to parameters: alignment, face, head motion, crops, texture, lips, and the build."""
