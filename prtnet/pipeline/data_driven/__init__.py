"""Data-driven transfer: databases of lightmaps under random lights, what is learned from them, how near it comes."""
