"""Names of logs, and which of them go when there are too many or the disk is full."""

from __future__ import annotations

import os
from calendar import timegm
from pathlib import Path
from typing import NamedTuple

import pytest

from tgl_soar.onboard.flightlog import files
from tgl_soar.onboard.flightlog.files import Kept, flight_name, kept_in, make_room, part_name

NOV_21 = timegm((2026, 11, 21, 14, 3, 55))
PLENTY = 10**12
KB = 1000


class DiskSpace(NamedTuple):
    """Of `os.statvfs`: free blocks, and bytes in each."""

    f_bavail: int
    f_frsize: int = 4


def put(folder: Path, name: str, size: int = 0) -> Path:
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(bytes(size))
    return path


@pytest.fixture(autouse=True)
def plenty_is_free(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "statvfs", lambda _folder: DiskSpace(PLENTY))


def with_free(monkeypatch: pytest.MonkeyPatch, size: int) -> None:
    """So many bytes, of which a tenth is left to others."""
    blocks = DiskSpace(round(size / 0.9 / 4) + 1)
    monkeypatch.setattr(os, "statvfs", lambda _folder: blocks)


# --- names ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("flight", "when", "name"),
    [
        (7, NOV_21, "2026-11-21/14_03_55_flight007"),
        (1234, NOV_21, "2026-11-21/14_03_55_flight1234"),
        (8, timegm((2025, 1, 1, 0, 0, 0)), "2025-01-01/00_00_00_flight008"),
        (8, timegm((2024, 12, 31, 23, 59, 59)), "undated/flight008"),
        (8, 0.0, "undated/flight008"),
    ],
)
def test_a_flight_is_named_by_day_hour_and_number_where_the_clock_is_set(
    tmp_path: Path, flight: int, when: float, name: str
) -> None:
    """This program is younger than 2025: an earlier day is that of a clock without a battery."""
    assert flight_name(tmp_path, flight, when) == tmp_path / name


def test_the_first_part_has_no_number_and_the_others_have() -> None:
    stem = Path("2026-11-21/14_03_55_flight007")
    assert [part_name(stem, part, "ulg").name for part in (1, 2, 11)] == [
        "14_03_55_flight007.ulg", "14_03_55_flight007_part2.ulg", "14_03_55_flight007_part11.ulg",
    ]  # fmt: skip
    assert part_name(stem, 1, "tlog") == Path("2026-11-21/14_03_55_flight007.tlog")


def test_logs_are_found_by_flight_and_part_with_their_sizes(tmp_path: Path) -> None:
    names = (
        "2026-11-21/14_03_55_flight007_part10.ulg",
        "2026-11-21/14_03_55_flight007.tlog",
        "undated/flight1008.ulg",
        "2026-11-22/09_00_00_flight007_part2.ulg",
        "2026-11-22/09_00_00_flight003.ulg",
    )
    paths = [put(tmp_path, name, 10 + k) for k, name in enumerate(names)]
    assert kept_in(tmp_path) == [
        Kept(3, 1, 14, paths[4]),
        Kept(7, 1, 11, paths[1]),
        Kept(7, 2, 13, paths[3]),
        Kept(7, 10, 10, paths[0]),
        Kept(1008, 1, 12, paths[2]),
    ]


@pytest.mark.parametrize(
    "name",
    [
        "2026-11-21/notes.txt",
        "2026-11-21/14_03_55_flight07.ulg",
        "2026-11-21/14_03_55_flight007.ulg.bak",
        "2026-11-21/copy_14_03_55_flight007.ulg",
        "2026-11-21/14_03_55_flight007_part.ulg",
        "mine/14_03_55_flight007.ulg",
        "2026-11-21-kept/14_03_55_flight007.ulg",
        "14_03_55_flight007.ulg",
    ],
)
def test_what_is_not_named_so_is_no_log_and_is_never_deleted(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = put(tmp_path, name, 5 * KB)
    assert kept_in(tmp_path) == []
    with_free(monkeypatch, 0)
    assert make_room(tmp_path, KB, KB, 9) == []
    assert path.exists()


def test_a_file_in_the_place_of_a_folder_and_no_folder_at_all_hold_no_logs(tmp_path: Path) -> None:
    put(tmp_path, "2026-11-21")
    assert kept_in(tmp_path) == []
    assert kept_in(tmp_path / "none") == []


# --- too many logs --------------------------------------------------------------------------------


def flights(folder: Path, *numbers: int, size: int = KB) -> None:
    for flight in numbers:
        put(folder, f"2026-11-21/10_00_00_flight{flight:03d}.ulg", size)


def gone(folder: Path, largest: int, coming: int, flying: int, first_parts: int = 0) -> list[int]:
    """Which flights lose their logs, of those that were there."""
    before = {kept.path for kept in kept_in(folder)}
    deleted = make_room(folder, largest, coming, flying, first_parts)
    assert before - {kept.path for kept in kept_in(folder)} == {each.path for each in deleted}
    return [each.flight for each in deleted]


@pytest.mark.parametrize(
    ("largest", "lost"),
    [
        (6 * KB, []),
        (5 * KB, []),  # to the last byte, with the one that is coming
        (5 * KB - 1, [1]),
        (4 * KB, [1]),
        (4 * KB - 1, [1, 2]),
        (0, [1, 2, 3, 4]),
    ],
)
def test_the_oldest_go_until_all_of_them_with_what_is_coming_fit(
    tmp_path: Path, largest: int, lost: list[int]
) -> None:
    flights(tmp_path, 1, 2, 3, 4)
    assert gone(tmp_path, largest, KB, 9) == lost


@pytest.mark.parametrize("first_parts", [0, 1, 2])
def test_of_the_flight_that_is_flown_the_first_parts_stay(tmp_path: Path, first_parts: int) -> None:
    flights(tmp_path, 4)
    for name in ("flight005", "flight005_part2", "flight005_part3"):
        put(tmp_path, f"undated/{name}.ulg", KB)
    deleted = make_room(tmp_path, 0, KB, 5, first_parts)
    assert [(each.flight, each.part) for each in deleted] == [
        (4, 1),
        *((5, part) for part in range(1 + first_parts, 4)),
    ]


# --- a full disk ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("free", "lost"),
    [
        (3 * KB, []),  # what is coming fits
        (2 * KB + 500, [1]),
        (1 * KB, [1]),  # half of the 4 kB that can be had is aimed at, of which 1 is there
        (200, [1, 2]),  # 2 kB are wanted then, of which two give 2
        (0, [1, 2]),
    ],
)
def test_a_full_disk_takes_older_flights_as_far_as_it_helps(
    tmp_path: Path, free: int, lost: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Flights 1 to 3 may go; 4 was the last, 5 is flown, and a part of 3 kB is coming."""
    flights(tmp_path, 1, 2, 3, 4, 5)
    with_free(monkeypatch, free)
    assert gone(tmp_path, PLENTY, 3 * KB, 5) == lost


def test_a_tenth_of_what_a_disk_has_left_is_not_for_logs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flights(tmp_path, 1, 2, 3, 4)
    for left, lost in ((1.13, []), (1.09, [1])):  # times what is coming
        blocks = DiskSpace(round(left * KB / 4))
        monkeypatch.setattr(os, "statvfs", lambda _folder, blocks=blocks: blocks)
        assert gone(tmp_path, PLENTY, KB, 5) == lost


@pytest.mark.parametrize(("coming", "lost"), [(3600, []), (3601, [1])])
def test_what_fits_to_the_last_byte_costs_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, coming: int, lost: list[int]
) -> None:
    """Of 4000 bytes a tenth is for others."""
    flights(tmp_path, 1, 2, 3, 4, 5, size=4 * KB)
    monkeypatch.setattr(os, "statvfs", lambda _folder: DiskSpace(1000))
    assert gone(tmp_path, PLENTY, coming, 5) == lost


def test_a_log_that_another_process_has_just_removed_is_gone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken = Kept(1, 1, KB, tmp_path / "2026-11-21/10_00_00_flight001.ulg")
    monkeypatch.setattr(files, "kept_in", lambda _folder: [taken])
    assert make_room(tmp_path, KB, KB, 5) == [taken]


def test_of_a_flight_that_has_no_first_parts_yet_all_may_go(tmp_path: Path) -> None:
    flights(tmp_path, 5)
    assert [each.flight for each in make_room(tmp_path, 0, KB, 5)] == [5]


@pytest.mark.parametrize("numbers", [(4, 5), (4,), (5,), ()])
def test_a_full_disk_takes_neither_the_last_flight_nor_the_one_that_is_flown(
    tmp_path: Path, numbers: tuple[int, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    flights(tmp_path, *numbers)
    with_free(monkeypatch, 0)
    assert gone(tmp_path, PLENTY, 3 * KB, 5) == []


def test_the_last_flight_is_the_one_before_whatever_its_number(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flights(tmp_path, 2, 7)
    with_free(monkeypatch, 0)
    assert gone(tmp_path, PLENTY, 2 * KB, 11) == [2]


def test_where_there_are_too_many_the_disk_does_not_keep_the_last_flight(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    flights(tmp_path, 1, 2)
    with_free(monkeypatch, 0)
    assert gone(tmp_path, 2 * KB, KB, 3) == [1]
    assert gone(tmp_path, KB, KB, 3) == [2]
