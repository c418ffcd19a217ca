"""The K-B plane of a device in a browser: how runs at walls end while the device is changed."""
