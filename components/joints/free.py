"""No joint at all: six freedoms."""

from acausal.mechanics.free import FreeJoint as Free

__all__ = ["Free"]
