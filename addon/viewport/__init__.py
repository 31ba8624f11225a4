"""Baked levels in the 3D view, seen from the view itself: transition, pruning and fades by shaders/leafcloud.glsl."""
