"""Recorded human motion: motion files, skeletons, and the way from a file's world to ours."""
