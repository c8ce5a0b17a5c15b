"""The stateless render service: a 6DoF pose in, one independent JPEG out."""
