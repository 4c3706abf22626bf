"""The live page of ``jssa-gym view``: a person dragged by the mouse beside a shielded arm, in a browser.

:class:`~jssa_gym.viewer.session.Session` plays and knows of no page; :mod:`~jssa_gym.viewer.page` shows it with viser,
which comes with the extra ``viewer``.
"""

from jssa_gym.viewer.choices import Choices, ShieldChoice
from jssa_gym.viewer.person import Dragged
from jssa_gym.viewer.session import Session
from jssa_gym.viewer.snapshot import Snapshot

__all__ = ["Choices", "Dragged", "Session", "ShieldChoice", "Snapshot"]
