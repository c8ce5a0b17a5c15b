"""Reports: one self-contained HTML page, JSON, a Markdown table and a figure, from run folders."""
