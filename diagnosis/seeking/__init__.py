"""Where to look: what each effect could explain of what a hypothesis leaves."""
