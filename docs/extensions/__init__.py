"""What the site needs beyond Sphinx's own extensions: small modules, one for each need."""
