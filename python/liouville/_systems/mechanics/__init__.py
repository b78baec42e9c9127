"""Systems of mechanics, and others on constraints."""
