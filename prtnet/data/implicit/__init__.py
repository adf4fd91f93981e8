"""Implicit surfaces: where a distance is zero. One description gives NumPy, compiled kernels, torch and GLSL."""
