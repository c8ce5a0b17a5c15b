"""Rasterisers: one interface (`base`), a fast one per device, and a short readable reference that tests compare with."""
