"""Where an index can be kept: sampled on the boundary of its safe set, searched for worse, mapped over parameters."""
