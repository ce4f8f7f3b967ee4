"""A driver that may be killed: does the points of a study that have no row yet."""

import sys

import small_work

from ann_dc.study.execution import execute
from ann_dc.study.store import Store


def main():
    folder, *doings = sys.argv[1:]
    with Store.begin(folder, {"title": "small"}, small_work.COLUMNS) as store:
        finished = store.finished()
        left = [point for point in small_work.points(*doings) if point.number not in finished]
        print("begun", flush=True)
        execute(small_work.tasks(left, 3), small_work.work, store, workers=2)


if __name__ == "__main__":
    main()
