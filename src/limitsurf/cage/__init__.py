"""What a cage is made of: integers, and points that are carried and never computed with."""
