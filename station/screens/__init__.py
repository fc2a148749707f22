"""The screens of the application. They ask and show; what is measured or computed happens in `station.jobs`' threads.

May import `station.widgets`, `station.commands` and what knows no terminal. A new screen is a class here, a mode in
`station.app`, and a command that leads to it.
"""
