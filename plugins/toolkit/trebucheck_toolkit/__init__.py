"""Parts of adapters for engines without stops, for trees of joints, and for engines in Node.js."""
