"""A scene's Gaussians as files, for clients that render them."""
