"""Helpers of HELIOS++ 2 for notebooks."""

from . import xmldisplayer as xmldisplayer
