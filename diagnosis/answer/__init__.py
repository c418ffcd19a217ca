"""From the result of the search to the answer: verdict, checks on held-out data, words, JSON."""
