"""Animations of walks: as a page for a browser or a notebook, as a GIF or as an MP4 file."""

from hexakin.animation.animation import Animation, animate

__all__ = ["Animation", "animate"]
