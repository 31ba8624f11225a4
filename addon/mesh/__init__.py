"""Readers of geometry: objects of the scene as arrays, divided into trees, leaves and trunk."""
