"""Tags of robots: words by which people group them. See README.md."""
