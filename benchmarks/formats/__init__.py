"""What each byte of a stateless frame buys: image formats against today's JPEG (docs/formats.md)."""
