"""The teacher follows by its momentum; buffers are copied; a resumed run goes on with it."""

from types import SimpleNamespace

import pytest
import torch

from rm3d_plugin.engine.hooks import EMATeacherHook


class Student(torch.nn.Module):
    """One weight, one buffer; remembers its teacher as a model does."""

    def __init__(self):
        super().__init__()
        self.weight = torch.nn.Parameter(torch.tensor([1.0]))
        self.register_buffer('seen', torch.tensor(0))
        self.teachers = ()

    def set_teacher(self, teacher):
        self.teachers = () if teacher is None else (teacher,)


def runner_of(model):
    return SimpleNamespace(model=model, iter=0)


def step(hook, runner, weight):
    with torch.no_grad():
        runner.model.weight.fill_(weight)
        runner.model.seen += 1
    hook.after_train_iter(runner, 0)
    runner.iter += 1


def test_it_follows_slowly_and_copies_buffers():
    model, hook = Student(), EMATeacherHook(momentum=0.75, start=2)
    runner = runner_of(model)
    hook.before_train(runner)
    step(hook, runner, 2.0)
    assert model.teachers == ()  # not yet
    step(hook, runner, 4.0)
    (teacher,) = model.teachers
    assert teacher.weight.item() == 4.0 and not teacher.weight.requires_grad and not teacher.training
    step(hook, runner, 8.0)
    assert teacher.weight.item() == 0.75 * 4 + 0.25 * 8 and teacher.seen.item() == 3
    hook.after_train(runner)
    assert model.teachers == ()


def test_a_checkpoint_keeps_the_teacher():
    runner, hook, kept = runner_of(Student()), EMATeacherHook(0.75), {}
    hook.before_train(runner)
    step(hook, runner, 2.0)
    step(hook, runner, 6.0)
    hook.before_save_checkpoint(runner, kept)
    again, resumed = runner_of(Student()), EMATeacherHook(0.75)
    resumed.after_load_checkpoint(again, kept)
    resumed.before_train(again)
    assert again.model.teachers[0].weight.item() == 3.0
    step(resumed, again, 3.0)
    step(hook, runner, 3.0)
    assert again.model.teachers[0].weight.item() == runner.model.teachers[0].weight.item()


def test_bad_settings():
    with pytest.raises(ValueError, match='momentum in'):
        EMATeacherHook(momentum=1.0)
