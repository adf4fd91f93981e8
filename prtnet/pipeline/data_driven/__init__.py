"""Data-driven transfer of a run: its database, its operator, its files, its score and its page.

Belcour, Deliot, Barbier and Soler 2022, *A Data-Driven Paradigm for Precomputed Radiance Transfer*.
"""
