"""Memory of bounded size."""

import pickle

import numpy as np

from rm3d_plugin.storage.recent import RecentItems


def size_of(array):
    return array.nbytes


def test_the_items_asked_for_longest_ago_are_forgotten():
    items, made = RecentItems(1, size_of), []

    def ask(key, kilobytes=400):
        def make():
            made.append(key)
            return np.zeros(kilobytes * 128)

        return items.get_or_make(key, make)

    first = ask('a')
    ask('b')
    assert ask('a') is first and made == ['a', 'b']
    ask('c')  # three do not fit: b goes
    assert len(items) == 2 and ask('a') is first
    ask('b')
    assert made == ['a', 'b', 'c', 'b']
    huge = ask('huge', 2000)  # has no room, and leaves that of the others alone
    assert len(items) == 3 and ask('huge', 2000) is huge and made.count('huge') == 1
    ask('b')
    assert ask('huge', 2000) is huge and made[-1] == 'huge'  # what is in memory takes no room
    ask('larger', 3000)
    assert len(items) == 3 and ask('huge', 2000) is not huge and made[-2:] == ['larger', 'huge']
    items.clear()
    assert len(items) == 0


def test_what_is_kept_does_not_travel():
    items = RecentItems(1, size_of)
    items.get_or_make('a', lambda: np.zeros(3))
    copy = pickle.loads(pickle.dumps(items))
    assert len(copy) == 0 and copy.get_or_make('a', lambda: np.ones(3)).tolist() == [1.0, 1.0, 1.0]
