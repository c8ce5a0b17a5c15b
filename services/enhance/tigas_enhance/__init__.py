"""Networks that a scene's own views train to enhance the low rungs of its quality ladder."""
