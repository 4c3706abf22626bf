"""From a scene to rows and from rows to a jerk."""
