from agents.mussel.stimuli import ContactClosed, ContactOpened, DockMoved
from apad_bridge.vehicle.vehicle_link import Carried, LetGo
from apad_bridge.world.contacts import Contacts


def test_a_dock_closes_once_moves_when_it_moves_and_opens_once() -> None:
    contacts = Contacts()
    assert contacts.take(Carried(0, 3, 1.0, 2.0)) == ContactClosed(1_000_000, 2_000_000)
    assert contacts.take(Carried(1, 3, 1.0, 2.0)) is None
    assert contacts.take(Carried(2, 3, 1.5, 2.0)) == DockMoved(1_500_000, 2_000_000)
    assert contacts.take(LetGo(3, 3)) == ContactOpened() and contacts.take(LetGo(4, 3)) is None


def test_what_was_held_before_is_not_closed_around_again() -> None:
    assert Contacts(held=[3]).take(Carried(0, 3, 1.0, 2.0)) == DockMoved(1_000_000, 2_000_000)
    assert Contacts(held=[3]).take(LetGo(0, 3)) == ContactOpened()
