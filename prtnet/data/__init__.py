"""Scene, samples, visibility and transfer: everything that is true before a network exists."""
