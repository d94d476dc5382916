"""A recording as one page of HTML that is self-contained: `page` joins `sections`, which are made of `elements`."""
