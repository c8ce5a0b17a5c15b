"""CMAF (ISO/IEC 23000-19) in bytes: boxes, the init segment (CMAF header) and chunks. Knows nothing of sockets."""
