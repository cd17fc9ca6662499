"""Presets: TOML files that ``--config`` takes by name."""
