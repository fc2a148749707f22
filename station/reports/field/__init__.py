"""The files of a field and the page that shows them."""
