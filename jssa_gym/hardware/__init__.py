"""Robots' own interfaces, each behind a :class:`~jssa_gym.Guard`: a folder a maker.

The class to begin from is :class:`~jssa_gym.hardware.fanuc.FanucStream`.
"""
