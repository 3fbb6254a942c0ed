"""Places on a twin's surface, lengths between them, and how sure both are."""
