import errno
import json
import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from wildpuppet import atomic
from wildpuppet.errors import StoreError
from wildpuppet.store import Question, Store, canonical, digest_of, digest_of_folder, given, why

QUESTION = Question("fit", 1, {"fit": {"area": 0.05, "steps": 60}}, {"puppet": "aa", "crops": "bb"})


def writer(text: str):
    def write(folder: Path) -> float:
        (folder / "value.txt").write_text(text)
        return 1.5

    return write


def test_key_is_blake2b_of_canonical_json_and_names_everything_that_matters() -> None:
    import hashlib

    text = '["fit",1,{"fit":{"area":0.05,"steps":60}},{"crops":"bb","puppet":"aa"}]'
    assert canonical(["fit", 1, QUESTION.settings, QUESTION.inputs]) == text
    assert QUESTION.key == hashlib.blake2b(text.encode(), digest_size=20).hexdigest()
    others = [
        Question("fit", 2, QUESTION.settings, QUESTION.inputs),
        Question("crop", 1, QUESTION.settings, QUESTION.inputs),
        Question("fit", 1, {"fit": {"area": 0.2, "steps": 60}}, QUESTION.inputs),
        Question("fit", 1, QUESTION.settings, {"puppet": "aa", "crops": "cc"}),
    ]
    assert len({QUESTION.key, *(other.key for other in others)}) == 5


def test_published_result_is_found_with_its_digest_and_nothing_is_left_beside(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    assert store.look_up(QUESTION) is None
    entry = store.publish(QUESTION, writer("hello"))
    found = Store(tmp_path / "store").look_up(QUESTION)
    assert found is not None
    assert (found.digest, found.seconds, found.key) == (entry.digest, 1.5, QUESTION.key)
    assert found.digest == digest_of_folder(found.folder)[0]
    assert (found.folder / "value.txt").read_text() == "hello"
    assert not list((tmp_path / "store" / "entries").glob(f"{atomic.PREFIX}*"))


def test_digest_covers_data_files_only(tmp_path: Path) -> None:
    first = Store(tmp_path / "a").publish(QUESTION, writer("same"))
    other = Question("fit", 7, {}, {})
    second = Store(tmp_path / "b").publish(other, writer("same"))
    assert first.digest == second.digest


def test_who_comes_second_uses_what_is_there(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")

    def overtaken(folder: Path) -> float:
        Store(tmp_path / "store").publish(QUESTION, writer("first"))
        return writer("second")(folder)

    entry = store.publish(QUESTION, overtaken)
    assert (entry.folder / "value.txt").read_text() == "first"
    assert store.publish(QUESTION, writer("third"), anew=True).digest != entry.digest


def test_many_writers_of_one_name_agree(tmp_path: Path) -> None:
    found: list[str] = []

    def work(number: int) -> None:
        entry = Store(tmp_path / "store").publish(QUESTION, writer(f"writer {number}"))
        found.append((entry.folder / "value.txt").read_text())

    threads = [threading.Thread(target=work, args=(number,)) for number in range(8)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(found) == 8
    assert len(set(found)) == 1


def test_truncated_entry_is_set_aside_and_made_anew(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    entry = store.publish(QUESTION, writer("hello"))
    (entry.folder / "value.txt").write_text("hel")
    assert store.look_up(QUESTION) is None
    assert store.publish(QUESTION, writer("hello")).digest == entry.digest


def test_failed_stage_leaves_nothing(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")

    def fail(folder: Path) -> float:
        (folder / "value.txt").write_text("half")
        raise ValueError("a bug")

    with pytest.raises(ValueError, match="a bug"):
        store.publish(QUESTION, fail)
    assert store.look_up(QUESTION) is None
    assert not list((tmp_path / "store" / "entries").iterdir())


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EACCES, errno.EROFS, errno.EDQUOT])
def test_disk_refusal_is_a_store_error_in_one_line(tmp_path: Path, number: int) -> None:
    store = Store(tmp_path / "store")

    def refuse(folder: Path) -> float:
        raise OSError(number, os.strerror(number), str(folder))

    with pytest.raises(StoreError, match="what was finished is kept") as caught:
        store.publish(QUESTION, refuse)
    assert "\n" not in str(caught.value)
    assert os.strerror(number) in str(caught.value)


@pytest.mark.parametrize("where", ["store.json", "record.json"])
def test_newer_store_is_refused_by_name(tmp_path: Path, where: str) -> None:
    store = Store(tmp_path / "store")
    entry = store.publish(QUESTION, writer("hello"))
    path = store.folder / where if where == "store.json" else entry.folder / where
    path.write_text(json.dumps(json.loads(path.read_text()) | {"schema": "wildpuppet.store/2"}))
    with pytest.raises(StoreError, match=r"newer wildpuppet .*store/2.*update wildpuppet"):
        Store(store.folder).look_up(QUESTION)
    assert (entry.folder / "value.txt").exists()


def test_somebody_elses_folder_is_not_taken_for_a_store(tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "cat.jpg").touch()
    with pytest.raises(StoreError, match="not a store"):
        Store(tmp_path / "photos")
    with pytest.raises(StoreError, match="found a file"):
        Store(tmp_path / "photos" / "cat.jpg")


def test_prune_keeps_what_runs_use(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    other = Question("crop", 1, {}, {})
    used, unused = store.publish(QUESTION, writer("used")), store.publish(other, writer("unused"))
    with store.working(other) as working:
        (working / "checkpoint").write_text("half")
    store.note_run("run", {"keys": [used.key]})
    pruned = store.prune()
    assert pruned.entries == 2
    assert pruned.num_bytes >= len("unused") + len("half")
    assert store.look_up(QUESTION) is not None
    assert not unused.folder.exists()
    store.forget_run("run")
    assert store.prune().entries == 1


def test_notes_that_others_write_or_forget_meanwhile_are_passed_over(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")
    store.note_run("ours", {"keys": ["key"]})
    (tmp_path / "store" / "runs" / f"{atomic.PREFIX}1-ab-theirs.json").write_text('{"ke')
    (tmp_path / "store" / "runs" / "forgotten.json").symlink_to(tmp_path / "nowhere")
    assert store.runs() == {"ours": {"keys": ["key"]}}


def test_checkpoint_outlives_a_failure_and_goes_with_the_result(tmp_path: Path) -> None:
    store = Store(tmp_path / "store")

    def stopped() -> None:
        with store.working(QUESTION) as working:
            (working / "checkpoint").write_text("step 100")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stopped()
    with store.working(QUESTION) as working:
        assert (working / "checkpoint").read_text() == "step 100"
    store.publish(QUESTION, writer("done"))
    assert not working.exists()


WRITE_AND_HANG = """
import sys, time
from pathlib import Path
from wildpuppet.store import Question, Store
def write(folder):
    (folder / "value.txt").write_text("half")
    print(folder, flush=True)
    time.sleep(60)
Store(Path(sys.argv[1])).publish(Question("slow", 1, {}, {}), write)
"""


def test_leftovers_of_the_killed_are_told_from_the_living(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(atomic, "YOUNG_SECONDS", 0.0)
    store = Store(tmp_path / "store")
    command = [sys.executable, "-c", WRITE_AND_HANG, str(store.folder)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        left = Path(process.stdout.readline().strip())
        assert left.is_dir()
        assert store.prune().leftovers == 0
        os.kill(process.pid, signal.SIGKILL)
    assert left.is_dir()
    assert store.prune().leftovers == 1
    assert not left.exists()
    assert store.look_up(Question("slow", 1, {}, {})) is None


def test_why_names_the_setting_the_version_and_the_input() -> None:
    changed = Question("fit", 2, {"fit": {"area": 0.2, "steps": 60}}, {"puppet": "aa", "crops": "cc"})
    assert why(changed, QUESTION) == "version 1 -> 2, settings.fit.area 0.05 -> 0.2, crops changed"
    assert why(QUESTION, None) == "it never ran"
    assert why(QUESTION, QUESTION) == "its result is no longer in the store"


def test_kept_value_is_read_once_and_only_when_asked() -> None:
    reads: list[int] = []
    kept = given([1, 2]).derived("sum", lambda values: (reads.append(1), sum(values))[1])
    assert not reads
    assert (kept.value, kept.value) == (3, 3)
    assert reads == [1]
    assert kept.digest == ["sum", [1, 2]]
    assert digest_of(kept.digest) != digest_of([1, 2])
