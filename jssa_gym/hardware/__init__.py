"""Robots' own interfaces, each behind a :class:`~jssa_gym.Guard`."""
