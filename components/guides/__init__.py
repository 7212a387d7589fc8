"""Joints along curves and over surfaces."""
