"""CMAF (ISO/IEC 23000-19) in bytes: boxes, the init segment (CMAF header) and chunks. Independent of sockets."""
