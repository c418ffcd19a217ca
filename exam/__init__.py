"""The exam: physics is concealed in recordings, diagnosed, and what was found is scored."""
