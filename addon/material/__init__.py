"""Readers of materials: the channels of a leaf or trunk material, as images, factors and colors."""
