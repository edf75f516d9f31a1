"""The recorder: a page on this machine in which a person draws paths over pictures of a table and judges them."""
