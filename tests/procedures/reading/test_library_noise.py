import os
import threading

from procedures.reading.library_noise import captured_noise


def test_library_lines_are_kept_and_others_passed_on(capfd):
    with captured_noise() as noise:
        os.write(2, b"photo.dng: Unexpected end of file\nthe stage moved\n")
    assert noise.errors
    assert capfd.readouterr().err == "the stage moved\n"


def test_continued_lines_of_a_library_are_kept(capfd):
    with captured_noise() as noise:
        os.write(2, b"[ERROR:0@0.031] global imread_: Unsupported number:\n>     'channels >= 1'\n> where\n\nmoved\n")
    assert noise.errors
    assert capfd.readouterr().err == "moved\n"


def test_silence_is_no_error(capfd):
    with captured_noise() as noise:
        pass
    assert not noise.errors
    assert capfd.readouterr().err == ""


def test_standard_error_works_after_a_failure_inside(capfd):
    try:
        with captured_noise():
            raise OSError("disk")
    except OSError:
        os.write(2, b"afterwards\n")
    assert capfd.readouterr().err == "afterwards\n"


def test_two_threads_do_not_lose_the_terminal(capfd):
    def read():
        for _ in range(20):
            with captured_noise():
                os.write(2, b"x")

    threads = [threading.Thread(target=read) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert capfd.readouterr().err.count("x") == 60
