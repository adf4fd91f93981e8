"""Cameras, G-buffers and the frames that are scored."""
