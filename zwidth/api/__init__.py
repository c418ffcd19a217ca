"""What is asked for from Python: a question a file, with the defaults of its command."""
