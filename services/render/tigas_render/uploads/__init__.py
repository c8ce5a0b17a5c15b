"""Files that pages bring, in parts, to become scenes."""
