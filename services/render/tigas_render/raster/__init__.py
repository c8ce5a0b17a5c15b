"""Rasterisers: one interface (`base`), a fast one per device, and a short readable reference for tests."""
