"""Following a log while it is written: what is wrong with it, what it says, how stiff a wall."""
