"""Helpers of HELIOS++ 2 for notebooks."""
