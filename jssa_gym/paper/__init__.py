"""The paper's experiments, run again, and what it says about them."""
