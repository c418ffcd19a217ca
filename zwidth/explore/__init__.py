"""The K-B plane of a device in a browser: what a wall becomes while its device is changed."""
