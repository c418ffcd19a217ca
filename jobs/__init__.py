"""Independent tasks on threads, in processes, on a cluster, and what they gave, kept."""
