"""The fulcrum's place: launch speed against l1, under two laws of a rest."""
