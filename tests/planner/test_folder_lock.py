import pytest

from planner.folder_lock import FolderInUse, FolderLock


def test_one_at_a_time_and_again_when_it_is_given_back(tmp_path):
    lock = FolderLock(tmp_path)
    with pytest.raises(FolderInUse) as refused:
        FolderLock(tmp_path)
    assert refused.value.holder.isdigit()
    lock.close()
    lock.close()
    FolderLock(tmp_path).close()


def test_a_file_that_is_no_lock_is_left_as_it_is(tmp_path):
    (tmp_path / "lock").write_text("precious")
    with pytest.raises(OSError, match="'lock' is not one of the studio's"):
        FolderLock(tmp_path)
    assert (tmp_path / "lock").read_text() == "precious"
