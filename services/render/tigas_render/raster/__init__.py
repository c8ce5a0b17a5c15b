"""Rasterisers: one interface (`base`) and one implementation per device."""
