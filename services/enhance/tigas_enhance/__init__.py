"""Networks, trained on a scene's own views, that enhance the low rungs of its quality ladder."""
