"""How like the real person: measures, references, and the evaluation of a database."""
