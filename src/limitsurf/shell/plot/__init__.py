"""Pictures of limit surfaces and of what makes them; `plots` holds the calls."""
