"""Models of the least number of states: equations in charts, and what is asked of them."""

from acausal.minimal.model import MinimalModel as MinimalModel
