"""Plugins of this kind; each module registers its own."""
