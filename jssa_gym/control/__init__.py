"""Nominal controllers: what a joint should do when nobody is near."""

from jssa_gym.control.cascade import Cascade

__all__ = ["Cascade"]
