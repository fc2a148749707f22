"""The screens of the application: questions and display; measurements run in threads of `station.app.background`.

May import `station.app.widgets`, `station.app.commands` and modules independent of the terminal. To add a screen, add a
class here, a mode in `station.app.app`, and a command that opens it.
"""
