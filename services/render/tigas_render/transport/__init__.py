"""HTTP/3 and WebTransport on aioquic: an ASGI server, and the render session that carries frames."""
