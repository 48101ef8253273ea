"""The Exudyn adapter. Absolute imports of `exudyn` inside this package mean the library."""
