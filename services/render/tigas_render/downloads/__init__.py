"""A scene's Gaussians as files for those who render them elsewhere."""
