"""Lamps near a scene and light from far away: what they are, how they are drawn at random, what they send directly."""
