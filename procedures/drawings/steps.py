"""ASCII drawings of the steps, shown until there is a photograph.

Each fits into 52 columns and 11 lines, the free space of a terminal of 80 x 24 next to the list of steps.
"""

from __future__ import annotations

from textwrap import dedent


def _drawing(text: str) -> str:
    return dedent(text).strip("\n")


PRINT = _drawing(r"""
    +--------------------+
    | #   #.:#.:.#.   #  |
    |     :#.#:#.:#      |   print it at 100 %,
    |     #.:#.:.#:      |   on matt paper
    |     .#:.#:#.#      |
    | #   :.#:.#.:#   #  |
    |                    |
    | |....:....|....:.| |   measure this ruler
    | 0              100 |   from 0 to 100
    +--------------------+
""")
MOUNT = _drawing(r"""
      wall                     lamp
       |                      /
       |                  . *        45 degrees,
      ||            .  '             both sides
      ||      . '
chart || - - - - - - - - - - - - [=O  camera
      ||      ' .
      ||            '  .
       |                  ' *
       |                      \
      seen from above          lamp
""")
DISTANCE = _drawing(r"""
wall
  |
 ||
 || - - - - - - - - - - - [=O    back or closer,
 ||                       <-->    as asked
  |<------ distance ----->

 the PSF's samples, and the cells of the chart:
  .  .  .  .  .    .  .  .  .  .    .  .  .  .  .
 |-|-|-|-|-|-|-|  |---|---|---|--  |-------|-------
 s/t 0.7 too far  s/t 1.3 is best  s/t 2.7 too near
""")
SQUARE = _drawing(r"""
      chart                      chart
       \\                          ||
        \\                         ||
         \\ - - - [=O              || - - - [=O
          \\                       ||
           \\                      ||

        turn it ...           ... until it faces
                                 the camera
      seen from above
""")
FOCUS = _drawing(r"""
    near  <-----  ring  ----->  infinity
               .-------.
             .'  | | |  '.
            /  .-------.  \
           |  /         \  |
           | |     O     | |    a small step at
           |  \         /  |    a time; autofocus
            \  '-------'  /     stays off
             '.         .'
               '-------'
""")
SHOTS = _drawing(r"""
       |
      ||                             hands off,
      ||                             nobody walks
chart || - - - - - - - - - - - - [=O
      ||                          |
      ||                         /|\
       |                        / | \

      several photographs, nothing changed
      between them
""")
TOUR = _drawing(r"""
    +--------------------------------+
    |[1]           [2]            [3]|
    |                                |
    |                                |
    |[6]           [5]            [4]|
    |                                |
    |                                |
    |[7]           [8]            [9]|
    +--------------------------------+
     the frame: the chart is photographed in
     each place, out to its corners
""")
VIEWS = _drawing(r"""
    +------------------------------+
    | /|                        |\ |  turn the chart by
    | ||         ____           || |  35 degrees to all
    | \|        /____\          |/ |  sides, as asked
    |                              |  in all places
    | ____                    ____ |  of the frame
    | \__/                    \__/ |
    +------------------------------+
     the frame: one photograph of each pose
""")
PANEL = _drawing(r"""
      panel
      |:::|
      |:::|
      |:::| . . .  [=O  camera: even light
      |:::|             over the whole frame
      |:::|
      |:::|
""")
DARK = _drawing(r"""
      panel, off
      |   |
      |   |
      |   |       #[=O  camera, covered
      |   |
      |   |
""")
WALL = _drawing(r"""
      wall, with detail of all sizes
       |
      :|
      .|
      ;| - - - - - [=O - - - - - - - - - - - [=O
      ,|           near                      far
      :|
      .|<--  d  -->
       |<-----------  given below  --------->
       |
""")
NEAR = _drawing(r"""
      wall
       |
      :|
      .|
      ;| - - - - - [=O
      ,|           camera, focused on the wall
      :|
      .|<--  d  -->
       |
""")
FAR = _drawing(r"""
      wall
       |
      :|
      .|
      ;| - - - - - - - - - - - - - - - - - - [=O
      ,|                              moved back,
      :|                              focused again
      .|<-----------  given below  --------->
       |
""")
SCENE = _drawing(r"""
       |     ___
       |    |   |        .-.
       |    |   |       (   )
       |    |___|        '-'      - - - - [=O
       |      :           :               rig
       |      :           :
      far            things at            lamp
              several distances           steady
""")
FIRST = _drawing(r"""
       ___                         1:  [=O
      |   |    .-.
      |   |   (   )  - - - - - - - - -
      |___|    '-'

      the first photograph; then nothing in the
      scene may be touched
""")
SECOND = _drawing(r"""
       ___                         1:  [=O
      |   |    .-.                 2:  [=o
      |   |   (   )  - - - - - - - - -
      |___|    '-'

      the second: another aperture or motion,
      the scene unchanged
""")
THIRD = _drawing(r"""
       ___                         1:  [=O
      |   |    .-.                 2:  [=o
      |   |   (   )  - - - - - -   3:  [=.
      |___|    '-'

      the third: yet another aperture or motion,
      the scene unchanged
""")
TRUTH = _drawing(r"""
       ___
      |   |    .-.
      |   |   (   )  - - - - - - -    [=O
      |___|    '-'                   -----

      the ground truth: the rig rests, or the
      aperture is the smallest
""")
