"""The screens of the application. They ask and show; `station.app.background` measures and computes in its threads.

May import `station.app.widgets`, `station.app.commands` and what knows no terminal. A new screen is a class here, a
mode in `station.app.app`, and a command that leads to it.
"""
