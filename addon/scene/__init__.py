"""Readers of the scene around a tree: files, cameras, lights and wind."""
