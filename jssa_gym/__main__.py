"""``python -m jssa_gym``."""

from jssa_gym.cli import main

main()
