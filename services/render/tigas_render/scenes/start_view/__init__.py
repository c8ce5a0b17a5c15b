"""The first view of a scene: its up axis and a start camera, derived from its Gaussians."""
