"""Units to pictures, sound and video."""
