"""Robots that move, in a page of a browser, a GIF or an MP4 file."""

from hexakin.animation.animation import Animation, animate

__all__ = ["Animation", "animate"]
