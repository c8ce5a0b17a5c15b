"""Network traces: what a link can carry over time, and where such traces come from. Nothing here touches a link."""
