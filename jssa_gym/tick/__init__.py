"""The control step: one compiled function for one arm and for thousands.

:func:`~jssa_gym.tick.decide.decide` reads as the algorithm. Everything around it only fills records and reads answers.
"""
