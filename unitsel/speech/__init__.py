"""Text into speech whose phonemes are known: espeak-ng, other programs, recordings."""
