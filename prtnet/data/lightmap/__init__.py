"""Lightmaps under many lighting configurations, and the path tracer that they are held against."""
