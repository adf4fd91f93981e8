"""A window on a scene: what one chooses and turns in it (`state`), how that is drawn (`picture`), and the window."""
