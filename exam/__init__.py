"""The exam: physics is concealed in recordings, diagnosed, and the answers are scored."""
