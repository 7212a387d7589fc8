"""No joint at all: six freedoms."""

from acausal.parts.free import FreeJoint as Free

__all__ = ["Free"]
