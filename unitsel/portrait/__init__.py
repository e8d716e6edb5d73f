"""A head made of one photo: its mask, its expressions, when it has them, and its life."""
