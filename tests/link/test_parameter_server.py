"""The parameter server as a ground station meets it."""

from math import inf, isfinite, nan
from struct import pack, unpack

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tgl_soar.config.parameters import INDEX, PARAMETERS, ParameterSet
from tgl_soar.link.messages import (
    PARAM_ERROR_DOES_NOT_EXIST,
    PARAM_ERROR_PERMISSION_DENIED,
    PARAM_ERROR_VALUE_OUT_OF_RANGE,
    Inbound,
    Outbound,
    ParamError,
    ParamRequestList,
    ParamRequestRead,
    ParamSet,
    ParamValue,
    Source,
    StatusText,
)
from tgl_soar.link.parameter_server import HASH, VALUES_PER_POLL, VALUES_PER_S, ParameterServer
from tgl_soar.link.telemetry import StatusTexts

OWN = Source(1, 191)
STATION = Source(255, 190)
REAL32, INT32, UINT8, REAL64 = 9, 6, 1, 10


def server() -> ParameterServer:
    return ParameterServer(OWN, ParameterSet())


def request(
    server: ParameterServer,
    message: Inbound,
    *,
    now_s: float = 0.0,
    flying: bool = False,
    source: Source = STATION,
) -> list[Outbound]:
    return server.handle(source, message, now_s, flying=flying)


def words(answers: list[Outbound]) -> str:
    return "".join(m.text for m in answers if isinstance(m, StatusText))


def collected(server: ParameterServer, seconds: float, step_s: float = 0.005) -> list[ParamValue]:
    values: list[ParamValue] = []
    for i in range(round(seconds / step_s)):
        polled = server.poll(i * step_s)
        assert len(polled) <= VALUES_PER_POLL
        values += [m for m in polled if isinstance(m, ParamValue)]
    return values


def test_a_listing_gives_every_parameter_once_in_under_two_seconds() -> None:
    served = server()
    assert request(served, ParamRequestList(1, 191)) == []
    values = collected(served, 2.0)
    assert [v.param_index for v in values] == list(range(len(PARAMETERS)))
    assert [v.param_id for v in values] == [p.name for p in PARAMETERS]
    assert {v.param_count for v in values} == {len(PARAMETERS)}
    assert {v.param_type for v in values} == {REAL32}
    assert served.poll(3.0) == []


@pytest.mark.parametrize("target", [(1, 191), (1, 0), (0, 0), (0, 191)])
def test_a_broadcast_is_meant_for_us_too(target: tuple[int, int]) -> None:
    served = server()
    request(served, ParamRequestList(*target))
    assert served.poll(0.0)


@pytest.mark.parametrize("target", [(1, 1), (2, 191), (1, 190), (255, 0)])
def test_what_is_meant_for_others_is_left_alone(target: tuple[int, int]) -> None:
    served = server()
    before = served.values
    assert request(served, ParamRequestList(*target)) == []
    assert request(served, ParamRequestRead(*target, "TGL_X", -1)) == []
    for name in ("TGL_X", "NOPE"):
        change = ParamSet(
            target_system=target[0],
            target_component=target[1],
            param_id=name,
            param_value=1.0,
            param_type=REAL32,
        )
        assert request(served, change) == []
    assert served.poll(0.0) == []
    assert served.values is before


def test_our_own_echo_is_not_answered() -> None:
    served = server()
    assert (
        request(
            served,
            ParamSet(
                target_system=1,
                target_component=191,
                param_id="TGL_X",
                param_value=1.0,
                param_type=REAL32,
            ),
            source=OWN,
        )
        == []
    )
    assert served.values["TGL_X"] == 0.0


def test_reading_by_name_and_by_index() -> None:
    served = server()
    request(served, ParamRequestRead(1, 191, "TGL_LEAN", -1))
    request(served, ParamRequestRead(1, 191, "", 0))
    first, second = served.poll(0.0)
    assert first == ParamValue(
        param_id="TGL_LEAN",
        param_value=15.0,
        param_type=REAL32,
        param_count=len(PARAMETERS),
        param_index=INDEX["TGL_LEAN"],
    )
    assert isinstance(second, ParamValue)
    assert second.param_index == 0


def test_reading_what_is_not_there() -> None:
    served = server()
    assert (
        words(request(served, ParamRequestRead(1, 191, "SYSID", -1))) == "SYSID: no such parameter"
    )
    assert "index 999" in words(request(served, ParamRequestRead(1, 191, "", 999)))
    # To all components: it is another one's parameter.
    assert request(served, ParamRequestRead(1, 0, "ARSPD_FBW_MIN", -1)) == []
    assert (
        request(
            served,
            ParamSet(
                target_system=1,
                target_component=0,
                param_id="ARSPD_FBW_MIN",
                param_value=1.0,
                param_type=REAL32,
            ),
        )
        == []
    )


def test_a_set_takes_effect_at_once_and_is_answered_with_the_exact_value() -> None:
    served = server()
    answers = request(
        served,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="TGL_X",
            param_value=0.1,
            param_type=REAL32,
        ),
    )
    assert len(answers) == 1
    assert isinstance(answers[0], ParamValue)
    assert answers[0].param_value == served.values["TGL_X"] == pytest.approx(0.1, rel=1e-7)


@pytest.mark.parametrize(
    ("name", "value", "kind", "reason"),
    [
        ("TGL_X", nan, REAL32, "not finite"),
        ("TGL_X", inf, REAL32, "not finite"),
        ("TGL_X", 501.0, REAL32, "allowed -500 to 500 m"),
        ("OP_ENGAGE", 0.5, REAL32, "whole numbers only"),
        ("TGL_LEAN", 2.0, REAL32, "must lean upwind"),
        ("TGL_X", 1.4e-45, INT32, "send it as REAL32"),  # the bytes of the integer 1
        ("TGL_X", nan, INT32, "send it as REAL32"),  # the bytes of the integer -1
        ("TGL_X", 1.065353216e9, INT32, "send it as REAL32"),
        ("TGL_X", 1.0, REAL64, "send it as REAL32"),
        ("TGL_X", 1.0, 0, "send it as REAL32"),
    ],
)
def test_a_refused_set_is_answered_with_what_stands_and_why(
    name: str, value: float, kind: int, reason: str
) -> None:
    served = server()
    before = served.values
    answers = request(
        served,
        ParamSet(
            target_system=1, target_component=191, param_id=name, param_value=value, param_type=kind
        ),
    )
    assert served.values is before
    assert answers[0] == served.value_message(INDEX[name])
    assert reason in words(answers)
    assert words(answers).startswith(name)
    assert served.counters.refused == 1


def test_an_unknown_name_is_reported() -> None:
    served = server()
    assert (
        words(
            request(
                served,
                ParamSet(
                    target_system=1,
                    target_component=191,
                    param_id="NOPE",
                    param_value=1.0,
                    param_type=REAL32,
                ),
            )
        )
        == "NOPE: no such parameter"
    )


def errors(answers: list[Outbound]) -> list[ParamError]:
    return [m for m in answers if isinstance(m, ParamError)]


def test_a_refusal_is_reported_to_programs_too() -> None:
    """PARAM_ERROR goes to the station that asked, and says which of the three it is."""
    served = server()
    unknown = request(
        served,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="NOPE",
            param_value=1.0,
            param_type=REAL32,
        ),
    )
    assert errors(unknown) == [
        ParamError(
            target_system=255,
            target_component=190,
            param_id="NOPE",
            param_index=-1,
            error=PARAM_ERROR_DOES_NOT_EXIST,
        )
    ]
    by_index = request(served, ParamRequestRead(1, 191, "", 999))
    assert errors(by_index) == [
        ParamError(
            target_system=255,
            target_component=190,
            param_id="",
            param_index=999,
            error=PARAM_ERROR_DOES_NOT_EXIST,
        )
    ]
    bad = request(
        served,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="TGL_LEAN",
            param_value=-30.0,
            param_type=REAL32,
        ),
    )
    assert errors(bad) == [
        ParamError(
            target_system=255,
            target_component=190,
            param_id="TGL_LEAN",
            param_index=-1,
            error=PARAM_ERROR_VALUE_OUT_OF_RANGE,
        )
    ]
    denied = served.refuse(
        STATION,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="TGL_X",
            param_value=1.0,
            param_type=REAL32,
        ),
        "not yours",
        0.0,
    )
    assert errors(denied) == [
        ParamError(
            target_system=255,
            target_component=190,
            param_id="TGL_X",
            param_index=-1,
            error=PARAM_ERROR_PERMISSION_DENIED,
        )
    ]
    assert (
        errors(
            request(
                served,
                ParamSet(
                    target_system=1,
                    target_component=191,
                    param_id="TGL_X",
                    param_value=1.0,
                    param_type=REAL32,
                ),
            )
        )
        == []
    )


def test_a_number_that_was_an_integer_at_the_station_is_taken() -> None:
    served = server()
    request(
        served,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="OP_ENGAGE",
            param_value=1.0,
            param_type=UINT8,
        ),
    )
    assert served.values["OP_ENGAGE"] == 1.0


def test_the_loop_rate_stays_while_flying() -> None:
    served = server()
    answers = request(
        served,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="LOOP_RATE",
            param_value=100.0,
            param_type=REAL32,
        ),
        flying=True,
    )
    assert "not while flying" in words(answers)
    assert served.values["LOOP_RATE"] == 200.0
    request(
        served,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="LOOP_RATE",
            param_value=100.0,
            param_type=REAL32,
        ),
    )
    assert served.values["LOOP_RATE"] == 100.0


def test_a_change_by_the_module_itself_is_reported() -> None:
    served = server()
    request(
        served,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="OP_ENGAGE",
            param_value=1.0,
            param_type=REAL32,
        ),
    )
    assert served.assign("OP_ENGAGE", 0.0) == [
        ParamValue(
            param_id="OP_ENGAGE",
            param_value=0.0,
            param_type=REAL32,
            param_count=len(PARAMETERS),
            param_index=INDEX["OP_ENGAGE"],
        )
    ]


def test_a_flood_of_requests_is_answered_at_its_own_pace() -> None:
    served = server()
    answered = 0
    for i in range(2000):
        now_s = i / 2000
        request(served, ParamRequestRead(1, 191, "", i % len(PARAMETERS)), now_s=now_s)
        request(served, ParamRequestList(1, 191), now_s=now_s)
        answered += len(served.poll(now_s))
    assert answered <= VALUES_PER_S + VALUES_PER_POLL
    assert answered >= 0.95 * VALUES_PER_S


def test_a_flood_of_bad_sets_is_reported_in_few_words_but_always_answered() -> None:
    served = server()
    values = texts = 0
    for i in range(1000):
        answers = request(
            served,
            ParamSet(
                target_system=1,
                target_component=191,
                param_id="TGL_X",
                param_value=nan,
                param_type=REAL32,
            ),
            now_s=i / 1000,
        )
        values += sum(isinstance(m, ParamValue) for m in answers)
        texts += sum(isinstance(m, StatusText) for m in answers)
    assert values == 1000
    assert 8 <= texts <= 13


def test_a_lost_answer_is_asked_for_again_by_index() -> None:
    served = server()
    request(served, ParamRequestList(1, 191))
    lost = {v.param_index for v in collected(served, 2.0) if v.param_index % 5 == 0}
    for index in sorted(lost):
        request(served, ParamRequestRead(1, 191, "", index), now_s=2.0)
    again: set[int] = set()
    for i in range(400):
        again |= {m.param_index for m in served.poll(2.0 + i * 0.005) if isinstance(m, ParamValue)}
    assert again == lost


# --- texts ------------------------------------------------------------------------


@given(st.text(max_size=400))
def test_texts_are_cut_into_chunks_that_join_again(text: str) -> None:
    chunks = StatusTexts().chunks(4, text)
    assert all(len(c.text) <= 50 for c in chunks)
    assert [c.chunk_seq for c in chunks] == list(range(len(chunks)))
    assert "".join(c.text for c in chunks) == text.encode("ascii", "replace").decode()[:250]
    assert len({c.id for c in chunks}) == 1
    assert (chunks[0].id == 0) == (len(chunks) == 1)


def test_long_texts_have_numbers_of_their_own() -> None:
    texts = StatusTexts()
    first, second = texts.chunks(4, "a" * 60), texts.chunks(4, "b" * 100)
    assert first[0].id != second[0].id
    assert second[-1].text == ""  # a full chunk would not end the text


# --- the hash of all -----------------------------------------------------------------------------


def hash_of(values: ParameterServer, *, component: int = 191) -> int:
    assert request(values, ParamRequestRead(1, component, HASH, -1)) == []
    (answer,) = collected(values, 0.1)
    assert (answer.param_id, answer.param_type) == ("_HASH_CHECK", 5)  # UINT32, as its bytes
    assert (answer.param_count, answer.param_index) == (len(PARAMETERS), 65535)
    (number,) = unpack("<I", pack("<f", answer.param_value))
    return int(number)


def px4_crc32(data: bytes, crc: int) -> int:
    """Bit by bit, as crc32part of NuttX does: begins with what it is given, inverts nothing."""
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0xEDB88320 if crc & 1 else 0)
    return crc


def test_the_hash_is_that_of_px4_over_names_and_values() -> None:
    values = server()
    crc = 0
    for name, value in sorted((p.name, v) for p, v in values.values):
        crc = px4_crc32(pack("<f", value), px4_crc32(name.encode(), crc))
    assert hash_of(values) == crc
    assert hash_of(values, component=0) == crc


def test_the_hash_changes_with_every_value_and_comes_back() -> None:
    values = server()
    before = hash_of(values)
    request(
        values,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="TGL_X",
            param_value=0.5,
            param_type=REAL32,
        ),
    )
    assert hash_of(values) != before
    request(
        values,
        ParamSet(
            target_system=1,
            target_component=191,
            param_id="TGL_X",
            param_value=ParameterSet()["TGL_X"],
            param_type=REAL32,
        ),
    )
    assert hash_of(values) == before


def test_the_hash_arrives_as_it_is_whatever_its_bits() -> None:
    values = server()
    numbers = set()
    for i in range(600):  # two in 256 have an exponent of ones, which is no number
        values.assign("TGL_X", i * 0.01)
        number = values._hash_message().param_value
        assert isfinite(number)
        numbers.add(number)
    assert len(numbers) == 600


def test_the_hash_is_in_no_list_and_setting_it_sets_nothing() -> None:
    values = server()
    request(values, ParamRequestList(1, 191))
    assert HASH not in {m.param_id for m in collected(values, 3.0)}
    before = values.values
    (answer,) = request(
        values,
        ParamSet(
            target_system=1, target_component=191, param_id=HASH, param_value=1.0, param_type=5
        ),
    )
    assert isinstance(answer, ParamValue)
    assert answer.param_id == HASH
    assert values.values is before
