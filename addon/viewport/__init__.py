"""What 3D views show of levels: the eye that they are seen from, and labels."""
