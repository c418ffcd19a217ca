"""Independent tasks on threads, in processes or on a cluster, and storage of their results."""
