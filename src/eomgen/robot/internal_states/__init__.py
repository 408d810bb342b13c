"""Laws with internal states of their own: their numbers, rules and states, one file each."""
