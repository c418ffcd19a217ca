"""What changes while a device is recorded, and what happens once."""
